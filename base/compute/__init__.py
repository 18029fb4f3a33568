"""Loops as machine code, threads, processes, and arrays that are used again."""
