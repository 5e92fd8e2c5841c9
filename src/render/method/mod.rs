//! The methods, one file each.

/// How gas is rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The cheapest method predicted to stay within the tolerance; until the planner exists: [`Method::Perspective`].
    #[default]
    Auto,
    /// Billboards parallel to the view plane (Johnson & McAllister 2005).
    Viewplane,
    /// Billboards through the centre facing their own eye (Johnson & McAllister 2005).
    Viewpoint,
    /// The exact projection of each ball: footprint at the perpendicular distance from ray to centre.
    Perspective,
}

impl Method {
    /// Every method that is built, in the order of the documentation.
    pub const ALL: &[Self] = &[Self::Viewplane, Self::Viewpoint, Self::Perspective, Self::Auto];

    /// Methods of the contract that are not built yet; asking for one is an error that says so.
    pub const PLANNED: &[&str] = &["spherical", "sheet", "slab", "reference"];

    /// The name that scene files and `--method` use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Viewplane => "viewplane",
            Self::Viewpoint => "viewpoint",
            Self::Perspective => "perspective",
        }
    }

    /// The method of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|method| method.name() == name)
    }
}
