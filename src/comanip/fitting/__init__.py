"""How models are fitted: EM's loop, first guesses, coordinates, streams, the choice of K."""
