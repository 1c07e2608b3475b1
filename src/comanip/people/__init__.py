"""People as partners and as teachers: what they intend, how their arms answer, how they misbehave."""
