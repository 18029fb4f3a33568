"""How one would solve the tasks with other people's libraries, a few lines each."""
