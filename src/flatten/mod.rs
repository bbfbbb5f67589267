//! Flattening: a disk-like mesh with holes to the plane, with a free boundary and no flips.
//!
//! The map of a patch is where its tactile images are drawn, so it should be as close to an
//! isometry as the skin's curvature allows, everywhere at once, and never fold. This module follows
//! Cannata, Denei and Mastrogiovanni, "On Internal Models for Representing Tactile Information"
//! (`(cannata)`), whose weighted sum of angle, area and perimeter distortion it minimises as one
//! nonlinear energy instead of by linear rows.
//!
//! # The energy
//!
//! Of a face of area `A`, let `J` be the 2 x 2 Jacobian from the skin to the plane and `s1 >= |s2|`
//! its signed singular values; of a boundary edge of length `L`, let `r` be its stretch; let `h` be
//! the mean edge. The map minimises (eq. 4 of `(cannata)`)
//!
//! ```text
//! E = sum over faces of A [ l1 (s1/s2 + s2/s1)/2 + l2 (s1 s2 + 1/(s1 s2))/2 ]
//!   + l3 h sum over boundary edges of L (r + 1/r)/2
//! ```
//!
//! Each term is 1 at an isometry, and a face that collapses costs infinitely much, so a descent
//! never flips one. There are no pins, and the boundary is free unless [`Boundary`] prescribes it. The alternative is the symmetric
//! Dirichlet energy, `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`. *Magnification* makes each face aim at `a^2
//! (rho / mean rho)^gamma` times its area, with `rho` the density of taxels and `a` their acuity, and
//! a face counts by the mean weight of its taxels.
//!
//! # The algorithm
//!
//! 1. **Domain.** Check that the mesh is a disk with holes; lay each face flat, in units of the
//!    square root of the whole area.
//! 2. **Start**, on the coarsest level: the spectral natural conformal map (`(mullen2008)`), one
//!    sparse Hermitian eigenproblem. Flipped faces are repaired locally (`(garanzha2021)`). If that
//!    fails, the map winds twice about a vertex, a hole is not a hole or its energy is beyond 50:
//!    the outer loop on a circle and holes closed by a vertex each (`(tutte1963)`), which cannot
//!    flip in exact arithmetic, solved again with springs that are stiff where the map is too large
//!    (`(yoshizawa2004)`). From a start that is still bad, faces flatter than a hundredth, then a
//!    thousandth are minimised as if they were so high first: needles would stop every step.
//! 3. **Minimise** by projected Newton: the Hessian of each face, clamped to be positive
//!    semi-definite along its four known eigenvectors (`(smith2019)`, `(teran2005)`), a step below
//!    the first collapse of a face (`(smith2015)`), a line search. Up to 10 000 vertices systems
//!    are factored, above solved by conjugate gradients.
//! 4. **Fill, if needed.** Where a hole turns inside out, the descent goes on from the last map
//!    that kept it with light triangles in the holes, which may not flip and are made anew every
//!    few steps; where the map overlaps itself, with such triangles also between its outer loop and
//!    a frame (`(jiang2017)`).
//! 5. **Next finer level**: undo the removals of the pyramid on the map, each vertex into the
//!    kernel of its ring, which next to a filler that closes, and go to 3. Small levels and suspicious ones are also solved from
//!    scratch, and the better map is kept. The table of all fallbacks is at the top of
//!    `levels/refine.rs`.
//! 6. **Place** every level: centred, turned to its main direction, as large as the skin, coarse
//!    levels like the finest.
//!
//! # Guarantees
//!
//! - The intrinsic method returns a map without flips on every level, or an error
//!   ([`FlattenError::NoStart`]).
//! - The intrinsic method keeps holes: one loop runs counter-clockwise, all others clockwise. With
//!   [`Overlap::Prevent`] its map is one to one.
//! - The same input gives the same bits with any number of threads.
//!
//! # Not guaranteed
//!
//! - The minimum is local; nothing proves that it is the global one.
//! - With [`Overlap::Allow`] a map may overlap itself. [`distortion()`] counts overlaps.
//! - [`Method::Conformal`] and [`Method::Linear`] may flip faces and overlap.
//! - Closed surfaces and handles are refused, and patches that bend round a limb stay rings, far
//!   from isometric: [`crate::cut`] finds a seam for them before.
//!
//! # Files, in reading order
//!
//! - `options`, `error`: what is asked for, and why it may fail; `flatten`: the two entry points
//! - `domain/` (`disk`, `elements`, `flatten_domain`, `magnification`, `prescribed`): what is known of
//!   the skin and its map
//! - `energy/` (`face_energy`, `objective`, `newton`): one face, all faces, the minimiser; a new energy
//!   goes into `face_energy`
//! - `start/` (`conformal`, `linear`, `tutte`, `untangle`): maps without another one to start from
//! - `bijective/` (`orientation`, `crossings`, `overlap`, `fillers`): whether a map overlaps itself,
//!   and how that is prevented
//! - `levels/` (`relax`, `insertion`, `refine`): least energy on one level; from one to the next
//! - `placement`: where the finished map lies; `distortion`: how faithful any map is;
//!   `convergence`: how far its minimisation came

mod bijective;
mod convergence;
mod distortion;
mod domain;
mod energy;
mod error;
#[expect(clippy::module_inception, reason = "the file is named after what it does")]
mod flatten;
mod levels;
mod options;
mod placement;
mod start;

pub(crate) use bijective::crossings::crossing_vertices;
pub use convergence::Convergence;
pub use distortion::{Distortion, distortion};
pub use error::FlattenError;
pub use flatten::{flatten, flatten_pyramid};
pub(crate) use flatten::{flatten_pyramid_with_convergence, flatten_roughly, flatten_with_convergence};
pub use options::{Boundary, Energy, FlattenOptions, Method, Overlap};
