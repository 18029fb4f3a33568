"""What people who train networks ask for beside the truth: labels of every A-scan, every pixel and every cell."""
