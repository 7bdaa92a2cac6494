//! Collada (.dae): the triangles of a scene, with the nodes' transforms and the file's unit.
//!
//! `up_axis` is passed over, as RViz does: robot files orient their meshes with `<origin>`.

use super::content::{MAX_DEPTH, MAX_WORK};
use std::collections::HashMap;

use roxmltree::{Document, Node, ParsingOptions};

use super::ContentError;
use crate::rotation::Vec3;
use crate::scan::check_up_to;

/// Rows of an affine transform.
type Transform = [[f64; 4]; 3];
const UNMOVED: Transform = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
/// Max number of elements of a document.
const MAX_NODES: u32 = 1 << 20;
/// Elements that hold faces. Lines have none.
const GROUPS: [&str; 5] = ["triangles", "polylist", "polygons", "tristrips", "trifans"];

pub(super) fn read(text: &str) -> Result<Vec<[Vec3; 3]>, ContentError> {
    // The parser compares every two attributes of a tag, so very many of them would take it hours.
    check_up_to(text, 0, &mut 0, MAX_NODES as usize).map_err(|excess| ContentError::Tags(excess.message))?;
    // A document type could expand a small file to an enormous text.
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options)?;
    let elements = || document.descendants().filter(Node::is_element);
    // Elements refer to each other by `id`, forwards as well as backwards.
    let by_id: HashMap<&str, Node> =
        elements().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let unit = elements().find(|node| named(node, "unit"));
    let metre =
        unit.and_then(|unit| unit.attribute("meter")?.parse::<f64>().ok()).filter(|metre| *metre > 0.0);
    // Collada's own default is the metre.
    let scale = metre.unwrap_or(1.0);
    let root = UNMOVED.map(|row| row.map(|x| x * scale));

    let mut reader = Reader { by_id, triangles: Vec::new(), work: 0 };
    let scenes: Vec<Node> = elements().filter(|node| named(node, "visual_scene")).collect();
    for scene in &scenes {
        reader.read_node(*scene, root, 0)?;
    }
    // A library of shapes without a scene.
    if scenes.is_empty() {
        for geometry in elements().filter(|node| named(node, "geometry")) {
            reader.read_geometry(geometry, root)?;
        }
    }
    Ok(reader.triangles)
}

/// Whether a node is an element of that name, whatever its namespace: some exporters leave it out.
fn named(node: &Node, name: &str) -> bool {
    node.is_element() && node.tag_name().name() == name
}

struct Reader<'a, 'input> {
    by_id: HashMap<&'a str, Node<'a, 'input>>,
    triangles: Vec<[Vec3; 3]>,
    /// Numbers and nodes that were read so far.
    work: usize,
}

impl<'a, 'input> Reader<'a, 'input> {
    fn find(&self, node: Node<'a, 'input>, attribute: &str) -> Option<Node<'a, 'input>> {
        self.by_id.get(node.attribute(attribute)?.strip_prefix('#')?).copied()
    }

    fn read_node(
        &mut self,
        node: Node<'a, 'input>,
        parent: Transform,
        depth: usize,
    ) -> Result<(), ContentError> {
        if depth > MAX_DEPTH {
            return Err(ContentError::Depth);
        }
        self.count(1)?;
        let mut transform = parent;
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "matrix" | "translate" | "rotate" | "scale" => {
                    // Transforms are listed from the outermost to the innermost.
                    transform = joined(transform, self.local(child)?)
                }
                "node" => self.read_node(child, transform, depth + 1)?,
                "instance_node" => {
                    // A node may name one that it lies in; the depth ends that.
                    if let Some(other) = self.find(child, "url") {
                        self.read_node(other, transform, depth + 1)?;
                    }
                }
                "instance_geometry" => {
                    if let Some(geometry) = self.find(child, "url") {
                        self.read_geometry(geometry, transform)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn read_geometry(
        &mut self,
        geometry: Node<'a, 'input>,
        transform: Transform,
    ) -> Result<(), ContentError> {
        for group in geometry.descendants() {
            self.count(1)?;
            if !GROUPS.iter().any(|name| named(&group, name)) {
                continue;
            }
            let children = || group.children().filter(Node::is_element);
            // A face without its holes would be larger than the real one.
            if children().any(|child| named(&child, "ph")) {
                return Err(ContentError::Holes);
            }
            let inputs = || children().filter(|child| named(child, "input"));
            let offset = |input: &Node| {
                input.attribute("offset").and_then(|text| text.parse::<usize>().ok()).unwrap_or(0)
            };
            // Indices of positions, normals and so on alternate: the largest offset shows how many belong to a
            // corner.
            let stride = inputs().map(|input| offset(&input)).max().unwrap_or(0).saturating_add(1);
            let Some(vertex) = inputs().find(|input| input.attribute("semantic") == Some("VERTEX")) else {
                continue;
            };
            let points = self.points(vertex, transform)?;
            let place = offset(&vertex);
            let sizes: Option<Vec<usize>> = match children().find(|child| named(child, "vcount")) {
                Some(counts) => Some(self.numbers(counts)?),
                None => None,
            };
            for corners in children().filter(|child| named(child, "p")) {
                let all: Vec<usize> = self.numbers(corners)?;
                let mut corners: Vec<usize> = all.chunks_exact(stride).map(|corner| corner[place]).collect();
                if named(&group, "tristrips") {
                    corners = unrolled(&corners)?;
                }
                let mut rest = &corners[..];
                let mut take = |size: usize| -> Result<(), ContentError> {
                    let (face, after) = rest.split_at_checked(size).ok_or(ContentError::Corners)?;
                    rest = after;
                    if self.triangles.len() + size > super::MAX_TRIANGLES {
                        return Err(ContentError::Triangles);
                    }
                    // A fan of triangles from the first corner, which is right for convex faces.
                    // A face of fewer than three corners gives no triangle.
                    for pair in face.get(1..).unwrap_or_default().windows(2) {
                        self.triangles.push(super::indexed(&points, [face[0], pair[0], pair[1]])?);
                    }
                    Ok(())
                };
                match &sizes {
                    Some(sizes) => sizes.iter().try_for_each(|&size| take(size))?,
                    // Each <p> of <polygons> and <trifans> is one face or fan; those of <triangles> hold many.
                    None if named(&group, "polygons") || named(&group, "trifans") => take(corners.len())?,
                    None => (0..corners.len() / 3).try_for_each(|_| take(3))?,
                }
            }
        }
        Ok(())
    }

    /// Positions of a group's vertices, transformed.
    fn points(&mut self, vertex: Node<'a, 'input>, transform: Transform) -> Result<Vec<Vec3>, ContentError> {
        let vertices = self.find(vertex, "source").ok_or(ContentError::Positions)?;
        self.count(vertices.children().count())?;
        // The input names <vertices>, which names the positions, or the positions themselves.
        let position = vertices.children().find(|input| input.attribute("semantic") == Some("POSITION"));
        let source = match position {
            Some(position) => self.find(position, "source").ok_or(ContentError::Positions)?,
            None => vertices,
        };
        self.count(source.children().count())?;
        let array =
            source.children().find(|child| named(child, "float_array")).ok_or(ContentError::Positions)?;
        let coordinates: Vec<f64> = self.numbers(array)?;
        let point = |point: &[f64]| {
            transform.map(|[x, y, z, shift]| x * point[0] + y * point[1] + z * point[2] + shift)
        };
        Ok(coordinates.chunks_exact(3).map(point).collect())
    }

    fn numbers<T: std::str::FromStr>(&mut self, node: Node) -> Result<Vec<T>, ContentError> {
        let texts = node.children().filter_map(|child| child.text());
        let mut numbers = Vec::new();
        for word in texts.flat_map(str::split_whitespace) {
            numbers.push(word.parse().map_err(|_| ContentError::Number)?);
            self.count(1)?;
        }
        Ok(numbers)
    }

    fn count(&mut self, work: usize) -> Result<(), ContentError> {
        self.work += work;
        if self.work > MAX_WORK {
            return Err(ContentError::Work);
        }
        Ok(())
    }

    /// The transform of one element.
    fn local(&mut self, node: Node) -> Result<Transform, ContentError> {
        let values: Vec<f64> = self.numbers(node)?;
        Ok(match (node.tag_name().name(), &values[..]) {
            // Row by row. The last row of an affine transform is always 0 0 0 1 and is not kept.
            ("matrix", [.., _, _, _, _]) if values.len() == 16 => {
                std::array::from_fn(|row| std::array::from_fn(|column| values[4 * row + column]))
            }
            ("translate", &[x, y, z]) => [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z]],
            ("scale", &[x, y, z]) => [[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]],
            ("rotate", &[x, y, z, degrees]) => match crate::rotation::unit([x, y, z]) {
                Some(axis) => {
                    let turn = crate::rotation::axis_angle(axis, degrees.to_radians());
                    crate::rotation::matrix(turn).map(|[x, y, z]| [x, y, z, 0.0])
                }
                // Exporters write 0 0 0 0 for no rotation.
                None if [x, y, z].iter().all(|x| x.is_finite()) => UNMOVED,
                None => return Err(ContentError::Number),
            },
            _ => {
                let element = node.tag_name().name().to_owned();
                return Err(ContentError::Transform { element, numbers: values.len() });
            }
        })
    }
}

/// Corners of a strip's triangles, three each. The order of every second one is turned, so that all show the same side.
fn unrolled(strip: &[usize]) -> Result<Vec<usize>, ContentError> {
    if strip.len() > super::MAX_TRIANGLES + 2 {
        return Err(ContentError::Triangles);
    }
    let triangle = |(place, corners): (usize, &[usize])| match place % 2 {
        0 => [corners[0], corners[1], corners[2]],
        _ => [corners[1], corners[0], corners[2]],
    };
    Ok(strip.windows(3).enumerate().flat_map(triangle).collect())
}

/// The inner transform, then the outer one.
fn joined(outer: Transform, inner: Transform) -> Transform {
    outer.map(|[x, y, z, shift]| {
        let mut row: [f64; 4] =
            std::array::from_fn(|column| x * inner[0][column] + y * inner[1][column] + z * inner[2][column]);
        row[3] += shift;
        row
    })
}
