"""What comes of a run of the bench: summaries, differences, tables, files and plots."""
