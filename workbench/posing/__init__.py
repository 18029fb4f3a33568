"""`endoct pose`: where a bore lies in the patient's CT, with what is handed over to other programs."""
