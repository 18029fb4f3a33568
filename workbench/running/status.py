"""Exit statuses of the command line."""

DONE, UNUSABLE_INPUT, WRONG_USAGE, NOT_ALIGNED, INTERRUPTED = 0, 1, 2, 3, 130
