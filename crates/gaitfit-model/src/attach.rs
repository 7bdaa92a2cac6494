//! MJCF `<attach>`: a body of another file, or all that its world holds, as a part of this robot.
//!
//! As MuJoCo 4.0 attaches it: names and classes of the other file get `prefix`, its classes do not inherit from those of this
//! file, and those elements of its other sections come along that refer to nothing but what is attached. Its meshes and
//! height fields lie where it says. Its options do not count. Its keyframes are left out and listed.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::attributes::{Attributes, Context};
use crate::defaults::APART;
use crate::error::ModelError;
use crate::options::Compiler;
use crate::replicate::{REFERENCES, REFERRING};
use crate::scan::{MAX_DEPTH, MAX_NODES};
use crate::shown::shown;
use crate::terrain::stem;
use crate::xml::{At, Attribute, Element};

/// Kinds of elements of a body whose names other sections refer to.
const NAMED: [&str; 6] = ["body", "joint", "freejoint", "geom", "site", "frame"];
/// Attributes that name a class, or something of the assets.
const PREFIXED: [&str; 6] = ["class", "childclass", "mesh", "hfield", "material", "texture"];

/// The document with everything attached; `None` without any `<attach>`.
///
/// # Errors
/// A model or a body that there is not, a compiler that differs, more elements than a file may have.
pub(crate) fn attached(ctx: &mut Context, document: &Element) -> Result<Option<Element>, ModelError> {
    if !holds(document) {
        return Ok(None);
    }
    let mut elements = 0;
    let whole = assembled(ctx, document, 0, &mut elements)?;
    Ok(Some(whole))
}

fn holds(element: &Element) -> bool {
    // The document below a <model> is not part of this one: `assembled` looks into it when it is attached.
    element.name == "attach" || element.children.iter().any(|child| child.name != "model" && holds(child))
}

/// The document with what it attaches; `nesting`: how many documents attach this one.
fn assembled(
    ctx: &mut Context,
    document: &Element,
    nesting: usize,
    elements: &mut usize,
) -> Result<Element, ModelError> {
    // A file is copied once for each time that it is attached.
    if nesting > 0 {
        *elements += size(document);
        if *elements > MAX_NODES {
            return Err(ctx.too_many(document.at, "elements with those of <attach>", MAX_NODES));
        }
    }
    let mut models = HashMap::new();
    let mut places = HashMap::new();
    let assets = document.children.iter().filter(|section| section.name == "asset");
    for model in assets.flat_map(|section| &section.children).filter(|child| child.name == "model") {
        // The loader has put the other document below the <model> that names it.
        let Some(root) = model.children.first() else { continue };
        let name = model.get("name").or(root.get("model")).unwrap_or("").to_owned();
        // Without a name of its own a model goes by the name that its file states.
        if let Some(first) = places.insert(name.clone(), model.at) {
            let message = format!(
                "two models of <asset> are called \"{}\"; the other is at {}",
                shown(&name),
                ctx.sources.place(first)
            );
            return Err(ctx.invalid(model.at, message, "give each <model> a `name` of its own"));
        }
        models.insert(name, root);
    }
    let mut compiler = Compiler::default();
    for section in document.children.iter().filter(|child| child.name == "compiler") {
        compiler.read(ctx, section)?;
    }
    let mut attacher = Attacher { ctx, models, compiler, nesting, elements, sections: Vec::new() };
    let mut whole = Element { children: Vec::new(), ..document.clone() };
    for section in &document.children {
        whole.children.push(match section.name.as_str() {
            "worldbody" => attacher.children(section, 1)?,
            _ => section.clone(),
        });
    }
    // Elements that come with attached models follow the file's own.
    whole.children.extend(std::mem::take(&mut attacher.sections));
    Ok(whole)
}

struct Attacher<'c, 's, 'e> {
    ctx: &'c mut Context<'s>,
    /// The other files, by name.
    models: HashMap<String, &'e Element>,
    /// How this file is to be read.
    compiler: Compiler,
    nesting: usize,
    /// Elements copied so far.
    elements: &'c mut usize,
    /// Sections of what was attached.
    sections: Vec<Element>,
}

impl Attacher<'_, '_, '_> {
    /// An element with its children, `depth` deep in the file.
    fn children(&mut self, element: &Element, depth: usize) -> Result<Element, ModelError> {
        if depth > MAX_DEPTH {
            return Err(self.ctx.too_many(element.at, "elements inside each other", MAX_DEPTH));
        }
        let mut copy = Element { children: Vec::new(), ..element.clone() };
        for child in &element.children {
            copy.children.push(match child.name.as_str() {
                "attach" => self.attach(child, depth)?,
                _ => self.children(child, depth + 1)?,
            });
        }
        Ok(copy)
    }

    /// A frame with what an `<attach>` names.
    fn attach(&mut self, element: &Element, depth: usize) -> Result<Element, ModelError> {
        let mut a = Attributes::new(element);
        let (model, body, prefix) = (a.text("model").unwrap_or(""), a.text("body"), a.text("prefix"));
        let (prefix, at) = (prefix.unwrap_or(""), element.at);
        a.finish(self.ctx)?;
        let Some(&root) = self.models.get(model) else {
            let message = format!("<attach> of the model \"{}\", which <asset> does not have", shown(model));
            let remedy = "add <model name=\"...\" file=\"...\"/> to <asset>, or correct the name";
            return Err(self.ctx.invalid(at, message, remedy));
        };
        if self.nesting >= MAX_NESTING {
            return Err(self.ctx.too_many(at, "models attached to each other", MAX_NESTING));
        }
        // The other file may attach files itself, which are put into it first.
        let other = assembled(self.ctx, root, self.nesting + 1, self.elements)?;
        let folder = self.asset_folder(&other, at)?;
        let mut parts = Vec::new();
        for world in other.children.iter().filter(|section| section.name == "worldbody") {
            match body {
                Some(name) => parts.extend(find(world, name).cloned()),
                None => parts.extend(world.children.iter().cloned()),
            }
        }
        if let (Some(name), true) = (body, parts.is_empty()) {
            let message = format!("the model \"{}\" has no body \"{}\"", shown(model), shown(name));
            return Err(self.ctx.invalid(
                at,
                message,
                "correct the name, or leave `body` out for the whole world",
            ));
        }
        let mut names = HashSet::new();
        for part in &mut parts {
            self.rename(part, prefix, &mut names, depth + 2)?;
        }
        self.bring_along(&other, &folder, prefix, &names, body.is_none())?;
        // The frame hands down the other file's main class, so that its parts do not get this file's defaults.
        let main = Attribute { name: "childclass".to_owned(), value: format!("{prefix}main"), at };
        Ok(Element { name: "frame".to_owned(), attributes: vec![main], children: parts, at })
    }

    /// The folder of another file's meshes and height fields.
    ///
    /// # Errors
    /// A file whose numbers mean something else than this one's.
    fn asset_folder(&mut self, other: &Element, at: At) -> Result<PathBuf, ModelError> {
        let mut compiler = Compiler::default();
        for section in other.children.iter().filter(|child| child.name == "compiler") {
            compiler.read(self.ctx, section)?;
        }
        match self.compiler.differs(&compiler) {
            None => {
                let file = PathBuf::from(self.ctx.sources.place(other.at).file);
                // A path that is not absolute would count from this file's own folder of meshes.
                let file = std::path::absolute(&file).unwrap_or(file);
                Ok(file.parent().unwrap_or(Path::new("")).join(&compiler.mesh_folder))
            }
            Some(setting) => Err(self.ctx.invalid(
                at,
                format!("the attached file has another `{setting}` of <compiler> than this file"),
                "write the same <compiler> in both files; without the attribute MuJoCo's default counts",
            )),
        }
    }

    /// Puts `prefix` before the names and classes of an element and those in it; `names` gets the names as they were.
    fn rename(
        &mut self,
        element: &mut Element,
        prefix: &str,
        names: &mut HashSet<String>,
        depth: usize,
    ) -> Result<(), ModelError> {
        // Files that attach each other multiply: the count bounds what a few lines can grow to.
        *self.elements += 1;
        if depth > MAX_DEPTH {
            return Err(self.ctx.too_many(element.at, "elements inside each other", MAX_DEPTH));
        }
        if *self.elements > MAX_NODES {
            return Err(self.ctx.too_many(element.at, "elements with those of <attach>", MAX_NODES));
        }
        for attribute in &mut element.attributes {
            let name = attribute.name == "name" && NAMED.contains(&element.name.as_str());
            if name {
                names.insert(attribute.value.clone());
            }
            if name || PREFIXED.contains(&attribute.name.as_str()) {
                attribute.value.insert_str(0, prefix);
            }
        }
        element.children.iter_mut().try_for_each(|child| self.rename(child, prefix, names, depth + 1))
    }

    /// The classes and assets of the other file, whose meshes lie in `folder`, and the elements of its sections that
    /// refer to what is attached. `whole`: all of its bodies are attached.
    fn bring_along(
        &mut self,
        other: &Element,
        folder: &Path,
        prefix: &str,
        names: &HashSet<String>,
        whole: bool,
    ) -> Result<(), ModelError> {
        let class = Attribute { name: "class".to_owned(), value: format!("{prefix}main"), at: other.at };
        let mut main = Element {
            name: APART.to_owned(),
            attributes: vec![class.clone()],
            children: Vec::new(),
            at: other.at,
        };
        for section in &other.children {
            let mut copy = section.clone();
            match section.name.as_str() {
                // The other file's classes come below its `main`, which is called `{prefix}main` here.
                "default" => {
                    for child in &mut copy.children {
                        self.rename(child, prefix, &mut HashSet::new(), 3)?;
                    }
                    main.children.extend(copy.children);
                }
                // Classes that the other file has got from a file that it attaches itself.
                APART => {
                    self.rename(&mut copy, prefix, &mut HashSet::new(), 2)?;
                    self.sections.push(copy);
                }
                "asset" => {
                    copy.children.retain(|child| child.name != "model");
                    for child in &mut copy.children {
                        locate(child, folder);
                        self.rename(child, prefix, &mut HashSet::new(), 3)?;
                        // `rename` prefixes names of bodies' elements only; those of assets follow here.
                        let name = child.attributes.iter_mut().find(|attribute| attribute.name == "name");
                        name.into_iter().for_each(|name| name.value.insert_str(0, prefix));
                        // Without it the mesh would get the scale of this file's main class.
                        if child.name == "mesh" && child.get("class").is_none() {
                            child.attributes.push(class.clone());
                        }
                    }
                    self.sections.push(copy);
                }
                "keyframe" if !section.children.is_empty() => {
                    let what = format!("<keyframe> of an attached file ({})", section.children.len());
                    self.ctx.drop_quietly(section.at, what, "keyframes of this file count");
                }
                name if REFERRING.contains(&name) => {
                    let mut kept = Vec::new();
                    for mut element in std::mem::take(&mut copy.children) {
                        // `refer` comes first, because it also puts the prefix before the references.
                        if refer(&mut element, prefix, names) || whole {
                            self.rename(&mut element, prefix, &mut HashSet::new(), 3)?;
                            // `rename` has prefixed the name of a coupling: it is a <joint>, too.
                            let renamed = NAMED.contains(&element.name.as_str());
                            let is_name = |one: &&mut Attribute| one.name == "name" && !renamed;
                            for name in element.attributes.iter_mut().filter(is_name) {
                                name.value.insert_str(0, prefix);
                            }
                            // Sections outside of bodies are in no frame that hands down a class: they name it
                            // themselves.
                            if element.get("class").is_none()
                                && matches!(name, "actuator" | "contact" | "equality")
                                && element.name != "exclude"
                            {
                                element.attributes.push(class.clone());
                            }
                            kept.push(element);
                        }
                    }
                    copy.children = kept;
                    self.sections.push(copy);
                }
                // Options, the compiler's settings and custom data do not come along.
                _ => {}
            }
        }
        self.sections.push(main);
        Ok(())
    }
}

/// Elements in an element, it included.
fn size(element: &Element) -> usize {
    1 + element.children.iter().map(size).sum::<usize>()
}

/// Max depth of files that attach each other.
const MAX_NESTING: usize = 8;

/// Gives a mesh or height field the whole path of its file, which lies in `folder`, and the name that it would get
/// from the file.
fn locate(asset: &mut Element, folder: &Path) {
    if !matches!(asset.name.as_str(), "mesh" | "hfield") {
        return;
    }
    let mut attributes = asset.attributes.iter_mut();
    let Some(file) = attributes.find(|one| one.name == "file" && !one.value.is_empty()) else { return };
    let name = Attribute { name: "name".to_owned(), value: stem(&file.value).to_owned(), at: file.at };
    file.value = folder.join(&file.value).to_string_lossy().into_owned();
    if asset.get("name").is_none() {
        asset.attributes.push(name);
    }
}

/// The body of this name in or below an element.
fn find<'e>(element: &'e Element, name: &str) -> Option<&'e Element> {
    element.children.iter().find_map(|child| {
        let is = child.name == "body" && child.get("name") == Some(name);
        if is { Some(child) } else { find(child, name) }
    })
}

/// Puts `prefix` before the `names` to which an element refers; whether it refers to one, and to nothing else.
fn refer(element: &mut Element, prefix: &str, names: &HashSet<String>) -> bool {
    // An element that also refers to something left behind would name nothing here.
    let (mut any, mut lost) = (false, false);
    for attribute in element.attributes.iter_mut().filter(|one| REFERENCES.contains(&one.name.as_str())) {
        match names.contains(&attribute.value) {
            true => attribute.value.insert_str(0, prefix),
            false => lost = true,
        }
        any = true;
    }
    for child in &mut element.children {
        let refers = refer(child, prefix, names);
        any |= refers;
        lost |= !refers && child.attributes.iter().any(|one| REFERENCES.contains(&one.name.as_str()));
    }
    any && !lost
}
