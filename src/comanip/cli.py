"""`python -m comanip.cli`, as scripts know it; the commands are in `comanip.commands`."""

from .commands.app import app, main

__all__ = ["app", "main"]

if __name__ == "__main__":
    main()
