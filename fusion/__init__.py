"""Two panoramas of one bore: aligned, segmented and scored."""
