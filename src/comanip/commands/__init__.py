"""What the command line does, one function a command; imported only when it runs."""
