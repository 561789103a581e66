"""How well a motion can be known: observability Gramian and Cramer-Rao bound along a truth."""
