"""The sides of a comparison or a pose: recordings, panoramas, masks, from where they lie to their evidence."""
