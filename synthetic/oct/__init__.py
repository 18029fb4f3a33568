"""What the catheter OCT records of the wall."""
