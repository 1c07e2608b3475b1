"""The safety envelope around any skill: limits, detectors, a second opinion."""
