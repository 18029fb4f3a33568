"""What every command needs while it runs: progress, interrupts, threads, errors, files."""
