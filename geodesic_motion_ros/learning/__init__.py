"""How a skill is learned, with torch."""
