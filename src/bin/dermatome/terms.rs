//! The words of tables and notes, defined at the end of each `--help`; `docs/terms.md` has them all.

/// Words of the measures of a map.
pub(crate) const OF_MAPS: &str = "\
Words:
  level            a mesh: level 0 is the skin, every further one is coarser
  field            a vertex above level 0 with the taxels that it stands for, each with a weight
  loop             a closed chain of edges with one face each: the rim of a patch or of a hole
  seam             the edges along which a surface is cut open to be mapped
  s1/s2            angle distortion of a face, the ratio of its stretches: mean and max; 1 is best
  area             area ratio, map over skin, as max(r, 1/r) at equal total areas: mean and max;
                   1 is best
  symm. Dirichlet  mean of s1^2 + s2^2 + 1/s1^2 + 1/s2^2 at the best scale; 4 is best
  flips            faces that the map mirrors or squeezes to nothing
  crossings        places where the map overlaps itself";

/// Words of meshes and their levels.
pub(crate) const OF_LEVELS: &str = "\
Words:
  level   a mesh: level 0 is the skin, every further one is coarser
  field   a vertex above level 0 with the taxels that it stands for, each with a weight
  loop    a closed chain of edges with one face each: the rim of a patch or of a hole";

/// Words of the list of patches.
pub(crate) const OF_PATCHES: &str = "\
Words:
  patch    one connected sheet of taxels on one link
  loop     a closed chain of edges with one face each: the rim of a patch or of a hole
  euler    vertices - edges + faces: 1 for a disk, 2 for a closed surface, 0 for a sleeve or torus
  spacing  the mean length of the edges
  present, absent, thermal   what a slot of the skin holds: a working taxel, none, a thermal pad";

/// Words of the answers of a lookup.
pub(crate) const OF_ANSWERS: &str = "\
Words:
  level   a mesh: level 0 is the skin, every further one is coarser
  field   a vertex above level 0 with the taxels that it stands for, each with a weight
  b0..b2  weights of the three corners of the face, which give a point in it
  u, v    position on the map in m, v upwards; px, py its pixel, from the upper left corner";
