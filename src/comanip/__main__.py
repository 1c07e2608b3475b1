"""`python -m comanip`."""

from .commands.start import main

main()
