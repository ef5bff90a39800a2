"""Quasi-static relaxation."""
import numpy as np
import os
from periporo.core.reductions import exact_sum

class RelaxationError(RuntimeError):
    """Equilibrium was not reached."""

class Relaxation:
    def __init__(self, name, tolerance, max_steps):
        self.name, self.tolerance, self.max_steps = name, tolerance, max_steps
        self.method=os.environ.get("RELAX","fire")
        self.alpha=.1; self.good=0; self.ke=0.
    def run(self, sim):
        p=sim.particles
        sim.rate_independent=True
        for o in sim.observers: o.start_stage(sim,self)
        p.velocity[:]=0
        sim.evaluate_forces()
        start=sim.step_number
        self.damp=0.
        while True:
            r=self.residual(sim)
            if (sim.step_number-start)%500==0: print(sim.step_number-start, r, flush=True)
            if r<self.tolerance: break
            if sim.step_number-start>=self.max_steps: raise RelaxationError("no")
            sim.step(); sim.reset_clock()
            getattr(self,self.method)(sim)
        p.velocity[:]=0
        print(self.method,'relaxed in',sim.step_number-start)
        sim.rate_independent=False
        for o in sim.observers: o.finish_stage(sim,self)
        sim.reset_clock()
    def residual(self, sim):
        p=sim.particles; f=sim.forces.total(); 
        free=self.free(sim)
        w=p.external_force[:p.owned]
        s=exact_sum(sim.comm, np.stack([((f*free)**2).sum(1),((w*free)**2).sum(1)],1))
        return float(np.sqrt(s[0]/s[1]))
    def free(self, sim):
        p=sim.particles
        free=np.ones((p.owned,p.dimension))
        for m in sim.prescribed_motions:
            rows=np.isin(p.id[:p.owned],m.ids)
            for a in m.velocities: free[rows,a]=0
        return free
    def fire(self, sim):
        p=sim.particles; f=sim.forces.total()*self.free(sim); v=p.velocity[:p.owned]
        s=exact_sum(sim.comm, np.stack([(f*v).sum(1),(v*v).sum(1)*1,(f*f).sum(1)],1))
        if s[0]>0:
            v[:]=(1-self.alpha)*v+self.alpha*np.sqrt(s[1]/s[2])*f
            self.good+=1
            if self.good>5: self.alpha*=.99
        else:
            v[:]=0; self.alpha=.1; self.good=0
    def kinetic(self, sim):
        p=sim.particles; ke=sim.ledger.kinetic()
        if ke<self.ke: p.velocity[:]=0; ke=0.
        self.ke=ke
    def viscous(self, sim):
        # adaptive dynamic relaxation: damping from the lowest frequency seen (Underwood 1983)
        p=sim.particles; f=sim.forces.total()*self.free(sim); n=p.owned
        v=p.velocity[:n]
        if hasattr(self,'fold') and len(self.fold)==n:
            dx=sim.dt*self.vold
            s=exact_sum(sim.comm,np.stack([-(dx*(f-self.fold)).sum(1), (p.mass[:,None]*dx*dx).sum(1)],1))
            om2=max(s[0]/s[1],0) if s[1]>0 else 0
            self.damp=2*np.sqrt(om2)
            c=self.damp*sim.dt
            v*=max(1-c,0)
        self.fold=f.copy(); self.vold=v.copy()
