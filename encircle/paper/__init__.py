"""The paper's five simulations, run here, and checks of what the paper claims about them."""
