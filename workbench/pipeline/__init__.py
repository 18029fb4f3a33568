"""From files to files: unrolling, comparing, simulating, summarising."""
