# SPDX-License-Identifier: GPL-3.0-or-later
"""PECS in Blender: spectral renders through a real lens."""
