"""The page on which a person lifts with the robot: one HTML file with the robot, the beam and the law in it (docs/page.md)."""
