# SPDX-License-Identifier: GPL-3.0-or-later
"""Material parameters -> 9-D appearance latents, and the autoencoder that defines those latents."""
