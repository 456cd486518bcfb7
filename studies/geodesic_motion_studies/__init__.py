"""What measures the product, and compares it with others: nothing of the product imports it."""
