// Sheens without textures.

fn texture_sheen() {}
