"""Templates of reports, by which their HTML is made."""
