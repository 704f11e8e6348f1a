# SPDX-License-Identifier: GPL-3.0-or-later
"""Keyframes, and pictures between them where motion does not explain the light. Imports spectral, scene, camera and
truth."""
