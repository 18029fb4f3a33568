"""Recordings whose files are named, copied, cut or coded as people have them: none may be believed wrongly."""
