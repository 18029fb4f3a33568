"""Templates of the start page and of a study's page."""
