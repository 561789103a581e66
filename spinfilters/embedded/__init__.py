"""The light filter as C for a microcontroller: models generated, covariance in structured UD form."""
