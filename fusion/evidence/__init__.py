"""What speaks for a cell on the samples of one side."""

MASK_MODALITY = "mask"
"""The modality of a panorama that is a mask drawn by hand."""
