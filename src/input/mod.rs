//! FROM WHERE: scene files, particle files, mesh files.
