"""Defaults of every simulation: the bundled example, the thesis' own problem (Tweddle 2013, chapter 6).

Python, the command line, campaigns and the analyser take them from here; nothing heavy is imported, so that help is quick.
"""

from typing import Final

RATE_RPM: Final = (0.5, 10.0, 0.5)
"""Initial rate about the principal axes x, y, z: nearly about the intermediate axis, one flip in a minute, so that the attitude
about the spin axis, the rates and the inertia are weakly observable."""
PRINCIPAL_MOMENTS: Final = (1.0322, 1.0, 0.8596)
"""About the principal axes x, y, z, any scale (Tweddle 2013, section 6.5.2)."""
EPOCHS: Final = 115
INTERVAL: Final = 0.5
"""Between epochs, s."""
LANDMARKS: Final = 4250
"""On the surface: 24,723 observations in 115 epochs with the recognition below."""
RADIUS_M: Final = 0.12
DETECTION: Final = 0.88
FACING_COSINE: Final = 0.4
RECOGNITION: Final = (0.45, 1.4)
"""Shapes of the Beta distribution of how often a landmark's appearance is known again."""
FEWEST_OBSERVATIONS: Final = 2
CANDIDATES: Final = 48
"""Motions drawn until the disturbing force does not carry one out of view."""
