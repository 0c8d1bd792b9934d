# SPDX-License-Identifier: GPL-3.0-or-later
"""What measures pictures: PSNR, SSIM, FLIP, HDR-FLIP, LPIPS, noise."""
