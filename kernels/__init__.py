"""Device code of wvr: Warp functions, structs and the kernel factories. No files, images, plots or policy."""
