//! A finished map, drawn on that of another skin and measured there.

use std::sync::Arc;

use crate::Error;
use crate::pipeline::attempts::keep_held;
use crate::pipeline::options::{BuildOptions, Numbers};
use crate::pipeline::{Built, Made, enlarge_pixels};
use crate::registration::{Onto, Registered, register};
use crate::run::Run;
use crate::skin::{PatchId, Skin};

impl Built {
    /// Draws the map, which was built of this skin with these options, on that of another skin ([`register`]). Patches
    /// without enough landmarks are no longer in the map; coarse levels that fold are left out, as after a build.
    ///
    /// # Errors
    /// As [`register`], and if no file can store the map.
    pub fn register(
        &mut self,
        skin: &Skin,
        options: &BuildOptions,
        onto: &Onto<'_>,
        run: Run<'_>,
    ) -> Result<Registered, Error> {
        let mut map = (*self.map).clone();
        let made_of = |id: PatchId| Made {
            left_out: self.left_out[id],
            is_by_dirichlet: self.by_dirichlet[id],
            ratio: self.unmagnified_ratios[id],
        };
        let before: Vec<(String, Made)> =
            map.patches.enumerate().map(|(id, patch)| (patch.name.clone(), made_of(id))).collect();
        let mut registered = register(&mut map, onto, run)?;
        let mut made = Vec::new();
        for patch in map.patches.iter_mut() {
            // Tangents that the skin does not state are those of the map.
            let states = skin.patches.iter().find(|other| other.name == patch.name);
            if states.is_some_and(|states| states.taxels.tangents.is_none()) {
                patch.set_tangents();
            }
            let more = keep_held(patch, options, Numbers::F32).map_err(|e| e.in_patch(&patch.name))?;
            let known = before.iter().find(|(name, _)| *name == patch.name).map(|(_, made)| *made);
            let known = known.unwrap_or_default();
            made.push(Made { left_out: known.left_out + more, ..known });
        }
        if options.pixel.is_none()
            && let Some(enlarged) = enlarge_pixels(&mut map, &mut made, options, &mut self.failed)?
        {
            self.enlarged = Some(enlarged);
        }
        registered.patches.retain(|on| map.patches.iter().any(|patch| patch.name == on.name));
        map.find_body(options.across);
        self.map = Arc::new(map);
        self.left_out = made.iter().map(|made| made.left_out).collect();
        self.by_dirichlet = made.iter().map(|made| made.is_by_dirichlet).collect();
        self.unmagnified_ratios = made.iter().map(|made| made.ratio).collect();
        Ok(registered)
    }
}
