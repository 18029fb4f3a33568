"""DICOM files, whatever they hold: told by their first bytes, read with bounds, their samples decoded."""
