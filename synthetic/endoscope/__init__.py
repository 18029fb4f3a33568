"""What the cone-mirror endoscope records of the wall."""
