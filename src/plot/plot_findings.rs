//! Pictures of files that are not a valid skin: all sheets in the world, with what
//! [`check`](crate::skin::check()) finds in red. What is drawn may break every rule of a mesh.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{TriMesh, rectangle_around},
    plot::{
        PlotError, PlotOptions,
        draw::{Camera, Marks, draw_findings},
        layout::{Caption, Slot, lay_out, printable, slots},
        patch_view::PatchView,
        picture::Picture,
        plot_map::{check_viewpoint, title},
    },
    skin::{Draft, Finding, FindingKind, Presence, TaxelId, world_pose},
};

/// Draws the triangles of a file in space, and in red the edges, vertices and triangles that
/// findings name. Lines that others hide are faint. Findings without a place, and those that say how
/// a sound surface is shaped (closed, with handles, in pieces), are not marked.
///
/// # Errors
/// If there is no finite position, the viewpoint is not a direction, or the picture is narrower than
/// 200 or larger than 16384 pixels a side.
pub fn plot_findings(
    draft: &Draft,
    findings: &[Finding],
    options: &PlotOptions,
) -> Result<Picture, PlotError> {
    let viewpoint = options.space.unwrap_or_default();
    check_viewpoint(viewpoint)?;
    let (mesh, marks) = gather(draft, findings);
    if mesh.positions.is_empty() {
        return Err(PlotError::Empty);
    }
    let count = mesh.positions.len();
    let (ids, presence) =
        (mesh.positions.ids().map(|v| TaxelId(v.raw())).collect(), IdVec::filled(Presence::Present, count));
    let names = draft.sheets.iter().map(|sheet| sheet.name.as_str());
    let name = names.clone().find(|name| !name.is_empty()).unwrap_or("the file").to_owned();
    let view = PatchView::new(&name, &mesh, DAffine3::IDENTITY, &ids, &presence, None);
    let camera = Camera::new(viewpoint, &mesh, DAffine3::IDENTITY);
    let slot = Slot {
        bounds: rectangle_around(mesh.positions.iter().map(|&p| camera.project(p))),
        caption: Caption {
            name: printable(&name),
            which: format!(", {count} vertices, {} triangles", mesh.triangles.len()),
            about: [in_words(findings), "red: what `check` finds".into()],
        },
    };
    let (rows, layout) = lay_out(vec![vec![Some(slot)]], |slot| slot, options.width_px)?;
    let placed = slots(&rows, |slot| slot);
    let mut groups = Vec::new();
    for (slot, place) in rows.iter().flatten().flatten().zip(layout.views(&placed)) {
        groups.push(layout.caption(&slot.caption, &place));
        groups.push(draw_findings(&view, &camera, &place, &marks));
    }
    groups.push(layout.scale_bar());
    Ok(Picture {
        title: title("The findings of", names.take(MOST_NAMES)),
        size_px: [layout.width, layout.height],
        em: layout.em,
        groups,
    })
}

/// A title holds no more names.
const MOST_NAMES: usize = 5;

/// How many elements each kind of finding names, as `3 non-manifold-edge`.
fn in_words(findings: &[Finding]) -> String {
    let mut counts = BTreeMap::new();
    for finding in findings {
        let size = if finding.kind.elements() == "edges" { 2 } else { 1 };
        *counts.entry(finding.kind).or_insert(0) += (finding.elements.len() / size).max(1);
    }
    let words: Vec<String> = counts.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
    if words.is_empty() { "no findings".into() } else { words.join(", ") }
}

/// The triangles that can be drawn, all sheets in the world, and what is marked on them.
fn gather(draft: &Draft, findings: &[Finding]) -> (TriMesh, Marks) {
    let (mut mesh, mut marks) = (TriMesh::default(), Marks::default());
    let mut places = Vec::new();
    for sheet in &draft.sheets {
        let link = sheet.link.filter(|link| link.index() < draft.links.len());
        let pose = link.map_or(DAffine3::IDENTITY, |link| world_pose(&draft.links, link));
        let add = |x: &DVec3| {
            let at = pose.transform_point3(*x);
            at.is_finite().then(|| mesh.positions.push(at))
        };
        let vertices: Vec<Option<VertexId>> = sheet.positions.iter().map(add).collect();
        let vertex = |k: usize| vertices.get(k).copied().flatten();
        let face = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|k| vertex(k as usize));
            Some(mesh.triangles.push([a?, b?, c?]))
        };
        let faces: Vec<Option<FaceId>> = sheet.triangles.iter().map(face).collect();
        places.push((vertices, faces));
    }
    let drawable = |finding: &&Finding| is_marked(finding.kind);
    for finding in findings.iter().filter(drawable) {
        let title = |name: &str| if name.is_empty() { "patch".to_owned() } else { name.to_owned() };
        let Some(at) = draft.sheets.iter().position(|sheet| title(&sheet.name) == finding.patch) else {
            continue;
        };
        let (vertices, faces) = &places[at];
        let elements = finding.elements.iter().filter_map(|&k| usize::try_from(k).ok());
        let vertex = |k: usize| vertices.get(k).copied().flatten();
        match finding.kind.elements() {
            "faces" => marks.faces.extend(elements.filter_map(|k| faces.get(k).copied().flatten())),
            "vertices" => marks.vertices.extend(elements.filter_map(vertex)),
            "edges" => {
                let ends: Vec<Option<VertexId>> = elements.map(vertex).collect();
                let edge = |ends: &[Option<VertexId>]| Some([(*ends.first()?)?, (*ends.get(1)?)?]);
                marks.edges.extend(ends.chunks(2).filter_map(edge));
            }
            _ => {}
        }
    }
    (mesh, marks)
}

/// Whether a finding names places that are wrong, not how a sound surface is shaped or what is known
/// of its taxels.
const fn is_marked(kind: FindingKind) -> bool {
    !matches!(
        kind,
        FindingKind::SeveralComponents
            | FindingKind::ClosedPatch
            | FindingKind::Handle
            | FindingKind::WindingAgainstNormals
            | FindingKind::DuplicateId
            | FindingKind::PlaceholderId
            | FindingKind::ConstantNormals
            | FindingKind::UnrelatedNormals
    )
}
