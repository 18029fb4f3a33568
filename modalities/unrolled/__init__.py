"""Images of a bore wall that another program has unrolled: columns run around it, rows along it."""
