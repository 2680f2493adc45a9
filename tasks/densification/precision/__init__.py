"""How precise heights are: among their neighbours, as estimates, and of the datum."""
