"""Networks: which there are, where their files come from, and running them."""
