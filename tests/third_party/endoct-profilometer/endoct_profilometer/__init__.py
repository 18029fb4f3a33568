"""A rotating laser line profilometer as a modality of endoct."""
