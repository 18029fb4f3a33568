"""Depth of the wall as the endoscope sees it: what lies behind the wall moves otherwise from frame to frame."""
