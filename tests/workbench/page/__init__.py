"""A package, so that all of its tests share one browser, which ends with the last of them."""
