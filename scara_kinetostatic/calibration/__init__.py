"""From touches to L̄ with its uncertainty."""
