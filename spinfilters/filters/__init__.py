"""Recursive estimators: EKF and UKF in square-root form, with landmarks, outliers, late measurements."""
