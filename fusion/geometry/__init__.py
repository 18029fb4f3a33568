"""Where the sides lie in each other's frame, and how images are brought there."""
