"""What cases are made of: simulated specimens, toy walls and toy strips."""
