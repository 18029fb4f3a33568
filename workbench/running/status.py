"""Exit statuses of the command line."""

DONE, UNUSABLE_INPUT, WRONG_USAGE, NOT_ALIGNED, INTERRUPTED = 0, 1, 2, 3, 130
DOUBTED = NOT_ALIGNED
"""With ``--strict``: done, but there is a doubt."""
UNTOLD = 3
"""Of `pose`: done, but where the bore lies cannot be told."""
