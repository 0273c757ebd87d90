"""What judges the program: closed forms, other integrators, the source paper, the program."""
