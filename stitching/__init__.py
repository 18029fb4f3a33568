"""The surface grid, strips and panoramas of a bore wall, and how strips are placed and blended on it."""
