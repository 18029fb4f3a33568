"""Files that are opened with care, and outputs that appear whole or not at all."""
