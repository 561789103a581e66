"""Attitude: quaternions, 4 x MRP, rotation matrices, axis-angle and Euler 3-2-1, written once in CasADi."""
