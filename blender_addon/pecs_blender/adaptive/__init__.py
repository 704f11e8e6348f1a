# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive time steps: keyframes, and pictures between them where motion does not explain the light. Imports
spectral, scene, camera and truth."""
