# SPDX-License-Identifier: GPL-3.0-or-later
"""Spectra, bands, and the colours of a Blender scene as values in bands. Imports no other part."""
