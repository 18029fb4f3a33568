"""The template of the board."""
