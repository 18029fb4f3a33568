"""Templates of the page, by which its HTML is made."""
