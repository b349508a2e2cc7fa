"""The paper's simulations, and what it claims of them."""
