"""Where one side's wall lies in the other side's frame."""
