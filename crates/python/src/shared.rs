//! What losses of one mesh share: its topology and the buffers of evaluations.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use meshslam_core::error::Result;
use meshslam_core::gradients::exact::Workspace;
use meshslam_core::mesh::Topology;
use meshslam_core::prepared::Recent;

/// Meshes that a new loss is compared with.
const MESHES: usize = 8;

/// Buffers that are kept for a mesh.
const WORKSPACES: usize = 16;

/// A mesh topology with buffers for those who evaluate it.
pub struct SharedMesh {
    pub topology: Topology,
    /// The vertices that many views were last asked for together.
    pub batches: Mutex<Recent>,
    #[expect(clippy::vec_box, reason = "buffers move in and out")]
    spare: Mutex<Vec<Box<Workspace>>>,
}

/// What a mutex holds; a thread that died meanwhile left nothing half done that results depend on.
pub fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SharedMesh {
    /// The mesh with these faces: one in use, or a new one.
    pub fn of(vertex_count: usize, faces: &[[i64; 3]]) -> Result<Arc<Self>> {
        static IN_USE: Mutex<Vec<Weak<SharedMesh>>> = Mutex::new(Vec::new());
        let same = |mesh: &Arc<Self>| {
            let topology = &mesh.topology;
            topology.vertex_count == vertex_count
                && topology.faces.len() == faces.len()
                && topology.faces.iter().zip(faces).all(|(a, b)| a.map(i64::from) == *b)
        };
        let mut in_use = locked(&IN_USE);
        in_use.retain(|mesh| mesh.strong_count() > 0);
        if let Some(mesh) = in_use.iter().filter_map(Weak::upgrade).find(same) {
            return Ok(mesh);
        }
        let topology = Topology::new(vertex_count, faces)?;
        let mesh = Arc::new(Self { topology, batches: Mutex::default(), spare: Mutex::default() });
        in_use.truncate(MESHES - 1);
        in_use.insert(0, Arc::downgrade(&mesh));
        Ok(mesh)
    }

    /// Evaluate with buffers that others used before.
    pub fn with_workspace<R>(&self, evaluate: impl FnOnce(&mut Workspace) -> R) -> R {
        let mut work = locked(&self.spare).pop().unwrap_or_default();
        let out = evaluate(&mut work);
        let mut spare = locked(&self.spare);
        if spare.len() < WORKSPACES {
            spare.push(work);
        }
        out
    }
}
