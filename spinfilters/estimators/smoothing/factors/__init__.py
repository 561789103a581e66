"""Terms of the cost: dynamics, sensors, landmark observations, priors."""
