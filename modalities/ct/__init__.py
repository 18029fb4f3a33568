"""Volumes of a patient as files have them: DICOM, NIfTI, NRRD and MetaImage, and the names of labels in them."""
