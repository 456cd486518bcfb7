"""What is asked of a planner and what it answers: settings, requirements, modes, verdicts."""
