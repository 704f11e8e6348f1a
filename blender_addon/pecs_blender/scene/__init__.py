# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes (.blend files and scene folders), their motion, and Cycles, which renders them. Imports spectral."""
