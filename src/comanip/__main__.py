"""`python -m comanip`."""

from .commands.app import main

main()
