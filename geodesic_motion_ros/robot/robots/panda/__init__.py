"""The Franka Emika Panda with its hand."""
