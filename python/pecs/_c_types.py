"""Types of C arguments: scalars, pointers, and whole arrays."""

import ctypes

import numpy as np

INT, INT64, DOUBLE = ctypes.c_int, ctypes.c_int64, ctypes.c_double
POINTER = ctypes.c_void_p  # handles, and memory of any type
TEXT = ctypes.c_char_p
FLOATS = np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS")
DOUBLES = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
INTEGERS = np.ctypeslib.ndpointer(np.int32, flags="C_CONTIGUOUS")
