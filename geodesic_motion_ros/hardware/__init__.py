"""Real arms: what they are sent every millisecond, by a process of its own, and what they answer."""
