"""Real aircraft."""
