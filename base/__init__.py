"""What everything else rests on: errors, arrays, files, numbers, machine code and processes."""
