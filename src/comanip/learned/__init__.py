"""What was learned: the value, how it is made, how it is stored."""
