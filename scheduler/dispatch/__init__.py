"""Who does which order: phases from state to proposals."""
