"""Process and measurement models, each written once over CasADi types."""
