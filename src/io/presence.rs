use crate::skin::Presence;

/// The number that stands for `presence` in tables and meshes.
pub(crate) fn presence_code(presence: Presence) -> u8 {
    match presence {
        Presence::Absent => 0,
        Presence::Present => 1,
        Presence::ThermalPad => 2,
    }
}

/// What the number `code` stands for.
pub(crate) fn presence_of(code: f64) -> Option<Presence> {
    [Presence::Absent, Presence::Present, Presence::ThermalPad]
        .into_iter()
        .find(|&p| f64::from(presence_code(p)) == code)
}
