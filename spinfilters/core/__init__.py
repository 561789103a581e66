"""Mathematics that all else stands on: conventions, attitude, dynamics, geometry, linear algebra, CasADi functions."""
