"""How near a picture is to another: image (PSNR, SSIM, L2), lpips."""
