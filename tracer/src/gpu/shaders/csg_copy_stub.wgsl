// CSG boxes are read where they are.

fn copy_csg(thread: u32) {}
