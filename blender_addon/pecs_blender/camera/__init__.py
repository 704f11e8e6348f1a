# SPDX-License-Identifier: GPL-3.0-or-later
"""The light on the film: lens cameras, passes, denoising, light meter. Imports spectral and scene."""
