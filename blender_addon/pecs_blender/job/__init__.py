# SPDX-License-Identifier: GPL-3.0-or-later
"""From options to a stack on the disk: plan, render, merge. Imports spectral, scene, camera, truth and adaptive."""
