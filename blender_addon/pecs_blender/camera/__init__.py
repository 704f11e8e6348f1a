# SPDX-License-Identifier: GPL-3.0-or-later
"""Light on the film: lens cameras, passes, diffraction, denoising. Imports spectral and scene."""
