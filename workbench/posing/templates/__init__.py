"""Templates of the pages of poses, by which their HTML is made."""
