"""What speaks for a cell on the samples of one side."""
