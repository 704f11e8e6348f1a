# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes to render (.blend files and scene folders), their time, and Cycles. Imports spectral."""
