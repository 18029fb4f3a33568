"""Raw spectra as a recording: from the counts of a detector to B-scans."""
