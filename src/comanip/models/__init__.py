"""Models of demonstrations: frozen parameters, and functions of them. numpy only; no skill, plant or loop is known."""
