//! COLLADA (`.dae`): the triangles of its scene.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DMat4, DVec3};
use roxmltree::{Node, NodeId};

use crate::io::error::Result;
use crate::io::file::xml::{Xml, child, children, text_of};
use crate::io::file::{Source, excerpt, finite};
use crate::io::mesh::polygon::{POLYGON_NEEDED, Polygons};
use crate::skin::{Draft, Remark, RemarkKind, Sheet};

/// Nodes in nodes, and nodes that nodes use.
const DEEPEST: usize = 1000;

/// Most triangles, and most nodes, of a scene: nodes that use others multiply without end.
const MOST_TRIANGLES: usize = 50_000_000;
const MAX_USES: usize = 1_000_000;

/// Reads a COLLADA file: every use of a mesh in the scene becomes a sheet, in m by the unit that the file gives;
/// without a scene, every mesh. Polygons become triangles, without their holes. Its `up_axis` does not turn it: robot descriptions take
/// coordinates as they are. Normals, colours, lines and what animates are left out.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let xml = Xml::parse(source)?;
    let root = xml.root();
    if root.tag_name().name() != "COLLADA" {
        return Err(xml.invalid(root, "another kind of XML", "COLLADA, whose first element is <COLLADA>"));
    }
    let ids = root.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let mut scene = Scene {
        xml: &xml,
        ids,
        metres: metres(&xml)?,
        sheets: Vec::new(),
        triangles: 0,
        uses: 0,
        transforms: HashMap::new(),
        miscounted: None,
        polygons: Polygons::default(),
    };
    let instance = child(root, "scene").and_then(|scene| child(scene, "instance_visual_scene"));
    let first = || child(child(root, "library_visual_scenes")?, "visual_scene");
    match instance.map(|instance| scene.used(instance)).transpose()?.or_else(first) {
        Some(visual) => scene.add_nodes(visual)?,
        None => {
            let library = child(root, "library_geometries");
            for geometry in library.into_iter().flat_map(|library| children(library, "geometry")) {
                scene.add_geometry(geometry, DAffine3::IDENTITY, None)?;
            }
        }
    }
    let remark = |what| Remark { patch: source.stem(), kind: RemarkKind::PassedOver { what } };
    let warped = scene.polygons.remark(source.stem());
    let remarks = scene.miscounted.into_iter().map(remark).chain(warped).collect();
    Ok(Draft { sheets: scene.sheets, remarks, ..Draft::default() })
}

/// The unit of length, in m.
fn metres(xml: &Xml<'_>) -> Result<f64> {
    let Some(unit) = child(xml.root(), "asset").and_then(|asset| child(asset, "unit")) else {
        return Ok(1.0);
    };
    // Programs write the decimal comma of the language that they run in.
    let text = unit.attribute("meter").unwrap_or("1");
    let metres = finite(&text.trim().replacen(',', ".", 1)).filter(|&metres| metres > 0.0);
    metres.ok_or_else(|| xml.invalid(unit, format!("meter={}", excerpt(text)), "a length above 0"))
}

struct Scene<'a, 'i> {
    xml: &'a Xml<'i>,
    ids: HashMap<&'a str, Node<'a, 'i>>,
    metres: f64,
    sheets: Vec<Sheet>,
    triangles: usize,
    /// Elements of nodes that were visited, each as often as its node is used.
    uses: usize,
    transforms: HashMap<NodeId, DAffine3>,
    /// The first element of polygons that has another number of them than it states, or corners left over.
    miscounted: Option<String>,
    polygons: Polygons,
}

impl<'a, 'i> Scene<'a, 'i> {
    /// The element that an attribute of another names.
    fn named(&self, node: Node<'a, 'i>, attribute: &str) -> Result<Node<'a, 'i>> {
        let url = self.xml.need(node, attribute)?;
        let found = url.strip_prefix('#').and_then(|id| self.ids.get(id)).copied();
        found.ok_or_else(|| {
            let found = format!("{attribute}={}", excerpt(url));
            self.xml.invalid(node, found, "# and the id of an element of this file")
        })
    }

    fn used(&self, instance: Node<'a, 'i>) -> Result<Node<'a, 'i>> {
        self.named(instance, "url")
    }

    /// Adds what hangs on the nodes of a scene, in the order of the file.
    fn add_nodes(&mut self, visual: Node<'a, 'i>) -> Result<()> {
        let mut open = vec![(visual, DAffine3::IDENTITY, 0)];
        while let Some((node, pose, depth)) = open.pop() {
            let first = open.len();
            for part in node.children().filter(Node::is_element) {
                // Each use counts before it is looked into.
                self.uses += 1;
                if depth > DEEPEST || self.uses > MAX_USES {
                    let needed = format!("at most {DEEPEST} nodes in each other, and {MAX_USES} uses in all");
                    return Err(self.xml.invalid(node, "more nodes, or nodes that use themselves", needed));
                }
                match part.tag_name().name() {
                    "node" => open.push((part, pose * self.transform(part)?, depth + 1)),
                    "instance_node" => {
                        let used = self.used(part)?;
                        open.push((used, pose * self.transform(used)?, depth + 1));
                    }
                    "instance_geometry" => {
                        self.add_geometry(self.used(part)?, pose, node.attribute("name"))?
                    }
                    "instance_controller" => {
                        return Err(self
                            .xml
                            .source
                            .unsupported((self.xml.line(part), ""), "a mesh that follows joints"));
                    }
                    _ => {}
                }
            }
            open[first..].reverse();
        }
        Ok(())
    }

    /// The transform of a node, which is read once however often the node is used.
    fn transform(&mut self, node: Node<'a, 'i>) -> Result<DAffine3> {
        if let Some(known) = self.transforms.get(&node.id()) {
            return Ok(*known);
        }
        let transform = transform(self.xml, node)?;
        self.transforms.insert(node.id(), transform);
        Ok(transform)
    }

    /// Adds a use of a mesh.
    fn add_geometry(&mut self, geometry: Node<'a, 'i>, pose: DAffine3, name: Option<&str>) -> Result<()> {
        // Splines and convex hulls are no meshes.
        let Some(mesh) = child(geometry, "mesh") else { return Ok(()) };
        let mut positions = None;
        let (mut triangles, mut polygons) = (Vec::new(), std::mem::take(&mut self.polygons));
        for part in mesh.children().filter(Node::is_element) {
            let kind = part.tag_name().name();
            let Some(shape) = Primitive::named(kind) else { continue };
            let (chains, left_over) = self.chains(part)?;
            let stated = part.attribute("count").and_then(|count| count.trim().parse::<usize>().ok());
            if left_over > 0 || stated.is_some_and(|count| count != chains.len()) {
                let (line, stated) =
                    (self.xml.line(part), stated.map_or("no number".into(), |count| count.to_string()));
                self.miscounted.get_or_insert_with(|| {
                    let found = chains.len();
                    format!("line {line}: <{kind}> states {stated} of them, has {found}, and {left_over} corners more, which are not read")
                });
            }
            let known = match positions.take() {
                Some(known) => known,
                None => self.positions(mesh)?,
            };
            let mut corners =
                chains.iter().flat_map(|chain| chain.holes.iter().chain([&chain.corners])).flatten();
            if let Some(&index) = corners.find(|&&index| index as usize >= known.len()) {
                let needed = format!("vertices below {}", known.len());
                return Err(self.xml.invalid(part, format!("vertex {index}"), needed));
            }
            for (k, chain) in chains.iter().enumerate() {
                let crossed = || {
                    let found = format!("polygon {k}, which crosses or touches itself");
                    self.xml.invalid(part, found, POLYGON_NEEDED)
                };
                let cut = shape.add_triangles(chain, &known, &mut triangles, &mut polygons);
                cut.ok_or_else(crossed)?;
            }
            positions = Some(known);
            if self.triangles + triangles.len() > MOST_TRIANGLES {
                let needed = format!("at most {MOST_TRIANGLES} triangles in all uses of meshes");
                return Err(self.xml.invalid(part, "more triangles", needed));
            }
        }
        self.polygons = polygons;
        let Some(mut positions) = positions else { return Ok(()) };
        self.triangles += triangles.len();
        for p in &mut positions {
            *p = self.metres * pose.transform_point3(*p);
            if !p.is_finite() {
                return Err(self.xml.invalid(geometry, "a vertex beyond all numbers", "finite coordinates"));
            }
        }
        // A mirror turns the triangles over.
        if pose.matrix3.determinant() < 0.0 {
            triangles.iter_mut().for_each(|t: &mut [u32; 3]| t.swap(1, 2));
        }
        let own = ["name", "id"].into_iter().find_map(|key| geometry.attribute(key));
        let name = name.or(own).map_or_else(|| self.xml.source.stem(), str::to_owned);
        self.sheets.push(Sheet { name, positions, triangles, ..Sheet::default() });
        Ok(())
    }

    /// The positions of a mesh, from the source that its `<vertices>` name.
    fn positions(&self, mesh: Node<'a, 'i>) -> Result<Vec<DVec3>> {
        let vertices = self.xml.need_child(mesh, "vertices")?;
        let input = children(vertices, "input").find(|input| input.attribute("semantic") == Some("POSITION"));
        let input =
            input.ok_or_else(|| self.xml.invalid(vertices, "no positions", "an <input> of POSITION"))?;
        let source = self.named(input, "source")?;
        let array = self.xml.need_child(source, "float_array")?;
        let accessor = child(source, "technique_common").and_then(|common| child(common, "accessor"));
        let count = |name: &str, default: usize| {
            let text = accessor.and_then(|accessor| accessor.attribute(name));
            let refuse =
                |text: &str| self.xml.invalid(source, format!("{name}={}", excerpt(text)), "a count");
            text.map_or(Ok(default), |text| text.trim().parse().map_err(|_| refuse(text)))
        };
        let (stride, offset) = (count("stride", 3)?, count("offset", 0)?);
        // The numbers whose parameter has no name are skipped, unless none has one.
        let params = accessor.into_iter().flat_map(|accessor| children(accessor, "param"));
        let named = params.enumerate().filter(|(_, param)| param.attribute("name").is_some());
        let mut axes: Vec<usize> = named.map(|(at, _)| at).collect();
        if axes.is_empty() {
            axes = vec![0, 1, 2];
        }
        let &[x, y, z, ..] = &axes[..] else {
            let found = format!("{} named elements <param>", axes.len());
            return Err(self.xml.invalid(source, found, "three, or none"));
        };
        if stride <= z {
            return Err(self.xml.invalid(source, format!("stride={stride}"), "positions of three numbers"));
        }
        let numbers = numbers(self.xml, array, finite, "finite numbers")?;
        let of = |p: &[f64]| Some(DVec3::new(*p.get(x)?, *p.get(y)?, *p.get(z)?));
        Ok(numbers.get(offset..).unwrap_or_default().chunks(stride).filter_map(of).collect())
    }

    /// The vertices of each polygon, strip or fan of an element, and how many numbers are left over.
    fn chains(&self, part: Node<'a, 'i>) -> Result<(Vec<Chain>, usize)> {
        let offset = |input: Node<'_, '_>| {
            let text = input.attribute("offset").unwrap_or("0");
            let refuse =
                |_| self.xml.invalid(input, format!("offset={}", excerpt(text)), "a number from 0 to 255");
            text.trim().parse::<u8>().map(usize::from).map_err(refuse)
        };
        let (mut stride, mut vertex) = (0, None);
        for input in children(part, "input") {
            let at = offset(input)?;
            stride = stride.max(at + 1);
            if input.attribute("semantic") == Some("VERTEX") {
                vertex = Some(at);
            }
        }
        let index = |word: &str| word.parse::<u32>().ok();
        let no_vertices = || self.xml.invalid(part, "no vertices", "an <input> of VERTEX");
        let list = |p: Node<'_, '_>| -> Result<Vec<u32>> {
            let numbers = numbers(self.xml, p, index, "numbers of vertices")?;
            let vertex = if numbers.is_empty() { 0 } else { vertex.ok_or_else(no_vertices)? };
            Ok(numbers.chunks_exact(stride.max(1)).map(|corner| corner[vertex]).collect())
        };
        let kind = part.tag_name().name();
        if !matches!(kind, "triangles" | "polylist") {
            let chain = |p: Node<'a, 'i>| match p.tag_name().name() {
                "p" => Ok(Some(Chain { corners: list(p)?, holes: Vec::new() })),
                // A polygon with holes.
                "ph" => {
                    let holes = children(p, "h").map(list).collect::<Result<_>>()?;
                    Ok(Some(Chain { corners: list(self.xml.need_child(p, "p")?)?, holes }))
                }
                _ => Ok(None),
            };
            let chains: Result<Vec<_>> = part.children().map(chain).filter_map(Result::transpose).collect();
            return Ok((chains?, 0));
        }
        let list = children(part, "p").map(list).collect::<Result<Vec<_>>>()?.concat();
        let counts = match kind {
            _ if list.is_empty() => return Ok((Vec::new(), 0)),
            "triangles" => vec![3; list.len() / 3],
            _ => match (child(part, "vcount"), part.attribute("count").and_then(|n| n.trim().parse().ok())) {
                // Some programs leave it out where all polygons are alike.
                (None, Some(count)) if count > 0 && list.len() % count == 0 && list.len() >= 3 * count => {
                    vec![list.len() / count; count]
                }
                _ => {
                    let counts = self.xml.need_child(part, "vcount")?;
                    numbers(self.xml, counts, |word| word.parse::<usize>().ok(), "counts")?
                }
            },
        };
        let mut rest = &list[..];
        let mut cut = |count: usize| {
            let (corners, after) = rest.split_at_checked(count)?;
            rest = after;
            Some(Chain { corners: corners.to_vec(), holes: Vec::new() })
        };
        let chains: Option<Vec<_>> = counts.iter().map(|&count| cut(count)).collect();
        let chains = chains.ok_or_else(|| {
            let found = format!("{} corners", list.len());
            self.xml.invalid(part, found, "as many corners as its <vcount> states")
        })?;
        Ok((chains, rest.len()))
    }
}

/// The vertices of a polygon, strip or fan, and of the holes of a polygon.
struct Chain {
    corners: Vec<u32>,
    holes: Vec<Vec<u32>>,
}

/// What the corners of an element make.
#[derive(Clone, Copy)]
enum Primitive {
    Polygon,
    /// Triangles around the first corner.
    Fan,
    /// Triangles of three neighbours each, every second one turned over.
    Strip,
}

impl Primitive {
    fn named(kind: &str) -> Option<Self> {
        match kind {
            "triangles" | "polylist" | "polygons" => Some(Self::Polygon),
            "trifans" => Some(Self::Fan),
            "tristrips" => Some(Self::Strip),
            _ => None,
        }
    }

    /// `None` if a polygon crosses itself.
    fn add_triangles(
        self,
        chain: &Chain,
        positions: &[DVec3],
        triangles: &mut Vec<[u32; 3]>,
        polygons: &mut Polygons,
    ) -> Option<()> {
        let Chain { corners, holes } = chain;
        if matches!(self, Self::Polygon) && !corners.is_empty() && (corners.len() != 3 || !holes.is_empty()) {
            let ring = |ring: &Vec<u32>| ring.iter().map(|&v| positions[v as usize]).collect::<Vec<_>>();
            let cut = polygons.cut(&ring(corners), &holes.iter().map(ring).collect::<Vec<_>>())?;
            let all = [&corners[..], &holes.concat()].concat();
            triangles.extend(cut.into_iter().map(|t| t.map(|k| all[k])));
            return Some(());
        }
        for (k, pair) in corners.windows(2).enumerate().skip(1) {
            let [a, b] = [pair[0], pair[1]];
            triangles.push(match self {
                Self::Strip if k % 2 == 1 => [corners[k - 1], a, b],
                Self::Strip => [a, corners[k - 1], b],
                _ => [corners[0], a, b],
            });
        }
        Some(())
    }
}

/// The numbers of a text.
fn numbers<T>(
    xml: &Xml<'_>,
    node: Node<'_, '_>,
    parse: impl Fn(&str) -> Option<T>,
    needed: &str,
) -> Result<Vec<T>> {
    let text = text_of(node);
    let words = text.split_ascii_whitespace();
    words.map(|word| parse(word).ok_or_else(|| xml.invalid(node, excerpt(word), needed))).collect()
}

/// The transform of a node: the product of those in it, in their order.
fn transform(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<DAffine3> {
    let mut all = DAffine3::IDENTITY;
    for part in node.children().filter(Node::is_element) {
        let kind = part.tag_name().name();
        let count = match kind {
            "matrix" => 16,
            "translate" | "scale" => 3,
            "rotate" => 4,
            "lookat" => 9,
            "skew" => 7,
            _ => continue,
        };
        let given = numbers(xml, part, finite, "finite numbers")?;
        if given.len() != count {
            return Err(xml.invalid(part, format!("{} numbers", given.len()), format!("{count}")));
        }
        let vector = |k: usize| DVec3::new(given[k], given[k + 1], given[k + 2]);
        all *= match kind {
            "matrix" => affine(&given),
            "translate" => DAffine3::from_translation(vector(0)),
            "scale" => DAffine3::from_mat3(DMat3::from_diagonal(vector(0))),
            "rotate" => vector(0)
                .try_normalize()
                .map_or(DAffine3::IDENTITY, |axis| DAffine3::from_axis_angle(axis, given[3].to_radians())),
            _ => return Err(xml.source.unsupported((xml.line(part), ""), kind)),
        };
    }
    Ok(all)
}

/// A matrix as it is written, row by row; its last row is that of an affine map.
fn affine(rows: &[f64]) -> DAffine3 {
    let all: [f64; 16] = std::array::from_fn(|k| rows.get(k).copied().unwrap_or_default());
    DAffine3::from_mat4(DMat4::from_cols_array(&all).transpose())
}
